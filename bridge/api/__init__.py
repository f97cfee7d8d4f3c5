"""The public interface, safe to use from several threads."""
