"""The kinds of file that raw records come in: one module for each kind, and the columns of numbers that they share."""
