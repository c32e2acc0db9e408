"""What a campaign may disperse, the state, the equations of motion and trim."""
