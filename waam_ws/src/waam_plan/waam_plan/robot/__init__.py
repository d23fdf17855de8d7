"""Programs for robots: Fanuc TP, KUKA KRL, ABB RAPID."""
