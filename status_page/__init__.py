"""A page in the browser: may the machine move, who has control, and what is to be done."""
