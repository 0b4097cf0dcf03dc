"""Run all benchmarks: `python -m benchmarks`."""

from benchmarks import flows, found_models, orchestration, pictures, polyhedra, preview, renewal, resampling

if __name__ == "__main__":
    resampling.main()
    renewal.main()
    polyhedra.main()
    flows.main()
    pictures.main()
    orchestration.main()
    preview.main()
    found_models.main()
