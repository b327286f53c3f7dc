"""The closed loop: planner, tracker and world together, replanned while the AV drives."""
