"""Long work in processes of its own: data sets, which a supervisor hands to workers, and the jobs of the sidebar."""
