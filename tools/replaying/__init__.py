"""What a site's boxes said, or would have said, as messages with the times at which to say them again."""
