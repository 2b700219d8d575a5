"""The subcommands of `base-station`, one file each: its arguments and what it does."""
