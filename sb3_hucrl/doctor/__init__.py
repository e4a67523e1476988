"""
What ``python -m sb3_hucrl.doctor`` looks at: the installation, piece by piece. It imports nothing of the rest of the
package, and tries the pieces in processes of their own, so that it can report what breaks the package's import.
"""
