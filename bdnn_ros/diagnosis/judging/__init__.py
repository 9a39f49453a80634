"""What was found is judged: parameters with uncertainty, rivals, and rows that were left out."""
