"""What a diagnosis adds to the robot: a model that predicts, and its files for other programs."""
