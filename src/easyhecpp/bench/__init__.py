"""Measuring: metrics, tables, and the benchmarks that fill them."""

from easyhecpp.bench.metrics import ErrorSummary, PoseError, summarise, wilson_interval
from easyhecpp.bench.solve import (
    CASES,
    Case,
    SolveBench,
    SolveRow,
    run_solve_bench,
)
from easyhecpp.bench.solve_table import solve_table
from easyhecpp.bench.table import Table, describe_machine

__all__ = [
    "CASES",
    "Case",
    "ErrorSummary",
    "PoseError",
    "SolveBench",
    "SolveRow",
    "Table",
    "describe_machine",
    "run_solve_bench",
    "solve_table",
    "summarise",
    "wilson_interval",
]
