"""Tables, pictures, video, HTML: views of run folders."""
