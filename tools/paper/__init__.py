"""The published simulation study of the method this project implements, reproduced: its chain and ours side by side."""
