"""The rows of an epoch: the lines of the work space, their noise, the atmosphere in them."""
