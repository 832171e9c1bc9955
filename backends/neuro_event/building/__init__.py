"""Conversion of a program to the arrays and tables that the compiled loop reads."""
