"""What is done with a frame besides detecting in it: a preview, a thumbnail, and whether the view has shifted."""
