"""Parts of the plan, each a generator of legs over one :class:`RecoveryContext`."""
