"""`python -m benchmarks`: everything there is to measure."""

from benchmarks.resampling import main

if __name__ == "__main__":
    main()
