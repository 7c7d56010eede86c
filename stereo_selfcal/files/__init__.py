"""Files that are read and written: parameters, rigs, results and exports.

``result_file`` and ``parameter_file`` are files, ``saved_result`` and ``node_settings`` say what is in them.
"""
