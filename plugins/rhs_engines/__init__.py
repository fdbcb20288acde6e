"""Where the jobs of a sweep run: this machine's processes, Dask, Slurm."""
