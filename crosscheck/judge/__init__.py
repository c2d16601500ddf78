"""What is right and how right: truths, budgets of error, comparisons, what is known already."""
