"""Speed against error; each benchmark prints a table and writes JSON and a plot under reports/."""
