"""What comes in beside the boxes' messages: input.py says what such a source is; the others are those there are."""
