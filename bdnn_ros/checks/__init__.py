"""Checks of recordings and descriptions before an identification or diagnosis can be trusted."""
