"""Files that are read and written: parameters, rigs, results, exports."""
