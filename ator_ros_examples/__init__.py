"""Programs that use ator_ros as a package of a user would: action servers, stand-ins, domains."""
