"""Speed of the exact solver, as tables: ``python -m benchmarks.solver_speed``.

A hundred thousand problems in one call, compared with DAQP's C code and a Python loop over DAQP; and one call for
one problem, compared with qpsolvers.
"""

from __future__ import annotations

from tensionlab.benchmark import speed


def main() -> None:
    """Print the tables of batches and of single calls."""
    print(speed.describe_kernels())
    print("                   µs a problem:     batch       batch    DAQP  DAQP, loop   ratio to      max gap")
    print("  n   m   wrenches            1 core   all cores    in C   in Python  DAQP in C            N")
    for components, cables in speed.SHAPES:
        for reachable in (True, False):
            row = speed.time_batches(components, cables, reachable)
            times = (row.one_core_s, row.all_cores_s, row.daqp_c_s, row.daqp_loop_s)
            cells = [f"{1e6 * value:11.3f}" for value in times]
            kind = "feasible   " if reachable else "infeasible "
            print(f"{components:3d} {cables:3d}   {kind} {' '.join(cells)} {row.ratio:10.3f} {row.gap_max:12.1e}")
    print("\nOne call, µs                               median   p99.9   p99.9 / median   uninterrupted")
    for components, cables in speed.CALL_SHAPES:
        for call in speed.time_calls(components, cables):
            print(
                f"n = {components}, m = {cables}  {call.caller:32s} {1e6 * call.median_s:7.1f} "
                f"{1e6 * call.p999_s:7.1f} {call.p999_s / call.median_s:16.1f} "
                f"{call.quiet_p999_s / call.median_s:15.1f}"
            )


if __name__ == "__main__":
    main()
