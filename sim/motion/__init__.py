"""Motion of the arm: planner, clearance, paths, scripted motions."""
