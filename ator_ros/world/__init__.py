"""The world: what is known of robot and ball, and how it is inferred from what is heard."""
