"""Training data: readers, cleaning, splits, augmentation."""
