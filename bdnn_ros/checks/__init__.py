"""What a recording and a description must be for an identification or a diagnosis to mean anything."""
