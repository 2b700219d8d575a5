"""The subcommands of `edge-node` that are not its loop."""
