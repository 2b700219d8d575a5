"""The mathematics: where the cameras stand and look, and where the object is. Pure: numpy in, frozen dataclass out."""
