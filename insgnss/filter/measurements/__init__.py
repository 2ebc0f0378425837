"""The kinds of measurements that the filter knows by itself: prediction, row of H and variance, one file for each."""
