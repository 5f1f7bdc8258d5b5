"""One sweep of four runs that take seconds, on an engine: ``python on_engine.py ENGINE FOLDER``."""

import sys
from pathlib import Path

from granular_lmp import Scene, sweep
from granular_lmp.studies.executors import mpi_workers

SCENE = Scene.load("tr_periodic").with_values(
    {"packing.rows": 80, "packing.columns": 8, "time.duration": 800.0, "output.checkpoint": 0.005}
)
OVER = {"wave.amplitude": [0.02, 0.05, 0.1, 0.2]}


def executor_of(engine: str, logs: Path):
    """Return the executor; the engines are imported here, as a machine may have some of them."""
    if engine == "mpi4py":
        return mpi_workers()
    if engine == "submitit":
        import submitit

        executor = submitit.AutoExecutor(folder=logs)
        executor.update_parameters(timeout_min=10, cpus_per_task=1, slurm_partition="all")
        return executor
    if engine == "executorlib":
        from executorlib import SlurmJobExecutor

        return SlurmJobExecutor(max_workers=2, block_allocation=True)
    from dask.distributed import Client
    from dask_jobqueue import SLURMCluster

    cluster = SLURMCluster(
        queue="all", cores=1, processes=1, memory="900MB", walltime="00:10:00", log_directory=str(logs), interface="lo"
    )
    cluster.adapt(minimum_jobs=2, maximum_jobs=2)
    return Client(cluster).get_executor()


if __name__ == "__main__":
    folder = Path(sys.argv[2])
    executor = executor_of(sys.argv[1], folder.with_suffix(".logs"))
    print(sweep(SCENE, OVER, folder, executor=executor))
    if hasattr(executor, "shutdown"):
        executor.shutdown()
