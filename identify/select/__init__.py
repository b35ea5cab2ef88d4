"""Selection of effects: score tests, candidates, forward selection, verdict."""
