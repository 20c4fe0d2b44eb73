"""What compensation gains a piezo stage that follows a triangle."""
