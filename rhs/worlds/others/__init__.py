"""Buildings in the forms of single programs: Open-RMF's traffic editor, Webots."""
