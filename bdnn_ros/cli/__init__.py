"""The command `bdnn`, one module a verb."""
