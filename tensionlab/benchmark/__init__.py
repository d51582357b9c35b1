"""Laboratory for solvers: problem sets, entries, measurement, results and comparisons."""

from tensionlab.benchmark.comparison import compare
from tensionlab.benchmark.experiment import run
from tensionlab.benchmark.problem_files import read_problem_set
from tensionlab.benchmark.problem_sets import problem_set
from tensionlab.benchmark.results import read

__all__ = ["compare", "problem_set", "read", "read_problem_set", "run"]
