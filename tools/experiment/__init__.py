"""The paper's experiments and comparisons of planners: runs, tables, figures and a report."""
