"""What makes the contact models that ship, and the regressors of others that studies hold them to."""
