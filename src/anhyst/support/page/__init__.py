"""What every page is made of: one style, one table, numbers as a reader wants them."""
