"""Task `localise`: a recording, or a robot that is led, in a map that is given."""
