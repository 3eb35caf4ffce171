"""What a controller's logs tell of its limits: what each axis reached, and what they cannot tell."""
