"""Where the tripods stand: occupations, their store, and the command that fills it."""
