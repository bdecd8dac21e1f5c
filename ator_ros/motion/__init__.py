"""Motion: how long turns, straights and two-turn ways take; used to plan and as ideal times."""
