"""Many runs: jobs and where they run."""
