"""What commands share: options, console, signals and files."""
