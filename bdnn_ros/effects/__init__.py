"""Effects: the physical causes a simulation may leave out, one class each."""
