"""The graph behind the job: topics, services, parameters."""
