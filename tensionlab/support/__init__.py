"""Arrays, tables, files, messages and other helpers of the whole package."""
