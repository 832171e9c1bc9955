"""Decisions while events arrive: beginnings learnt apart, sessions, and when to stop."""
