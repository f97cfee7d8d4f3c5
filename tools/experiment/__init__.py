"""The paper's experiments and the comparison of planners, as runs, tables, figures, a report."""
