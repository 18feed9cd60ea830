"""Scene code shared by the artist's buttons and the headless pipelines; no user interface in here."""
