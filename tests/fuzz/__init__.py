"""Every reader and every saved run on damaged input: it gives a result, or an error of the package's own."""
