"""The first task: a cost map that ranks templates, trained on what drivers did."""
