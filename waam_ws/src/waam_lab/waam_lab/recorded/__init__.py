"""The simulated cell fitted to recordings that are no jobs: arc logs, cooling curves, walls with their scans."""
