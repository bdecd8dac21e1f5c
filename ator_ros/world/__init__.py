"""The estimated state of robot and objects, and its estimation from messages."""
