"""Built-in simulator of vehicles, with plans, margins and exports."""
