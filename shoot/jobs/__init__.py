"""Work in other processes, and what is said when one of them was killed."""
