"""First-party degradations: what happens to captures between the source and the sensor."""
