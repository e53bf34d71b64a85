#!/bin/bash
# A cohort as one array job: each task does its part of the list, all write into one folder at the same time.
#
#   sbatch --array=1-100 examples/slurm_array.sh subjects.csv results
#
# A second submission goes on where the first one ended, and tries again what failed. A task ends with code 7 when
# subjects of its part failed; they are in results/failures.csv.
#SBATCH --job-name=cohort
#SBATCH --cpus-per-task=2
#SBATCH --mem-per-cpu=1G
#SBATCH --time=12:00:00
set -euo pipefail

manifest=$1
results=$2

exec quadriform cohort "$manifest" -o "$results" --resume \
  --shard "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT" --processes "${SLURM_CPUS_PER_TASK:-1}"
