"""The solver benchmark (``tensionlab bench``): problem sets, entries, evaluation, results and report.

`run` runs it, `results` holds the table, `report` writes it up.
"""
