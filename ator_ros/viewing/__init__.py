"""What a view shows and does, apart from the page that shows it and from ROS."""
