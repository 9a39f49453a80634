"""From messages to samples: validated, merged, time-stamped, and buffered for the trainer."""
