"""What depends on how a robot moves, behind the interface `base.Base`."""
