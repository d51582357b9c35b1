"""Parts that the verbs share."""
