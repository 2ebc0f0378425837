"""The rows of an epoch: what each line of the work space holds, its noise, what the air adds to it."""
