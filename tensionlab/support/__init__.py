"""Arrays, tables, files and whatever else every room needs and no user looks for."""
