"""The second trusted room: claims about a record, and how they are checked."""
