"""The world: what is known of robot and objects, and how it is inferred from what is heard."""
