"""What a job is made of: goal, program, records, geometry; pure."""
