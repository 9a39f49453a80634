"""Where and when something pushed or touched: one place and time after another, looked for in the residual."""
