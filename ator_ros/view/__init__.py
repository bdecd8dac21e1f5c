"""The page in the browser: what it draws, edits and executes, and the server, without ROS."""
