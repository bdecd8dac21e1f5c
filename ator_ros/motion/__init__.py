"""Motion within limits: durations of turns, straights and two-turn manoeuvres, to plan and as ideal times."""
