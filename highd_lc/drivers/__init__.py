"""Drivers fitted to recorded car-following: objectives, optimisers, what the data tell of them."""
