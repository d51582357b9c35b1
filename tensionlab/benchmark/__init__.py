"""One honest benchmark: problem sets x solvers x settings, measured alike, to one table and one report.

`run` measures, `results` holds the table, `report` writes it up, `readme` fills the README's table.
"""
