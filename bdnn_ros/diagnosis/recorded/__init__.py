"""What a diagnosis asks of recordings before it looks for causes: excerpts, low-passes, times and sensors."""
