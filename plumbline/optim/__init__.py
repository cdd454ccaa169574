"""Problems stated as symbols, and what solves them."""
