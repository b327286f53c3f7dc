"""Losses of plans, under what they were made for and under what they were not."""
