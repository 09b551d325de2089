"""Sites made up, with exact labels."""
