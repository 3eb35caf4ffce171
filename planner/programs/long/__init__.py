"""Part programs of any length, planned in windows."""
