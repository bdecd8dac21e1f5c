"""ROS 2 adapters: parameters, topics, services, actions."""
