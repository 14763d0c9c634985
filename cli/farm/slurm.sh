#!/bin/bash
# The shots of a jobs file as an array job of Slurm, a chunk of rows a task.
#
#   bash anyface.sh      hands the array in, and after it a job that writes the sum of all reports
#   sbatch anyface.sh    hands the array in alone
#
# A task whose node fails is queued again. The rows that it has finished are not done again.
# `anyface batch --export slurm` fills in: name, program, arguments (the command of a node), rows,
# chunk (rows a task), chunks (tasks), memory_mb, cores, seconds (the limit of a task).
#SBATCH --job-name={{name}}
#SBATCH --array=1-{{chunks}}
#SBATCH --cpus-per-task={{cores}}
#SBATCH --mem={{memory_mb}}M
#SBATCH --time=0:{{seconds}}
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --output={{name}}-%a.log

command=({{program}} {{arguments}})
rows={{rows}}
chunk={{chunk}}
export RAYON_NUM_THREADS="${SLURM_CPUS_PER_TASK:-{{cores}}}"

if [ -z "${SLURM_ARRAY_TASK_ID:-}" ]; then
    # This runs on the machine that hands the job in: logs are written beside this file.
    cd "$(dirname "$0")" && array=$(sbatch --parsable "${0##*/}") || exit
    after="afterany:${array%%;*}"
    exec sbatch --dependency="$after" --job-name={{name}}-sum --array=0 "${0##*/}" sum
fi
if [ "${1:-}" = sum ]; then
    exec "${command[@]}" --sum
fi
first=$(((SLURM_ARRAY_TASK_ID - 1) * chunk + 1))
last=$((first + chunk - 1 < rows ? first + chunk - 1 : rows))
exec "${command[@]}" --rows "$first-$last"
