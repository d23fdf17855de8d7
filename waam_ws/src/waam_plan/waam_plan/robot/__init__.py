"""Programs for robots: Fanuc TP, KUKA KRL, ABB RAPID; their readers; and the run on the simulated robot."""
