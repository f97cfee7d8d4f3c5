"""Recording a run to MCAP, and reading one back."""
