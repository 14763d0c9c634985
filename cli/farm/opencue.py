"""The shots of a jobs file as an OpenCue job. Each frame runs a chunk of rows.

    python submit.py            submits it to the Cuebot of CUEBOT_HOSTS
    python submit.py --print    prints the job's description instead

It needs `pip install opencue-pyoutline`. `anyface batch --export opencue` fills in: name, program,
arguments (the command of a node), rows, chunk (rows per frame), memory_mb, cores.
"""

import shlex
import sys

import outline
import outline.cuerun
from outline.modules.shell import Shell

COMMAND = [{{program}}, {{arguments}}]
ROWS, CHUNK = {{rows}}, {{chunk}}


def build():
    """Builds the job: the rows, then a layer that writes the sum of all reports.

    The last layer also waits for dead frames: retry or eat them.
    """
    job = outline.Outline("{{name}}")
    total = layer("sum", "1-1", 1, "--sum")
    whole = ROWS // CHUNK * CHUNK
    # Many Cuebots set #FRAME_END# of a shorter last chunk as if the chunk were full. So the rows
    # that are left over get a layer of their own.
    for name, first, last in (("shots", 1, whole), ("rest", whole + 1, ROWS)):
        if first <= last:
            size = min(CHUNK, last - first + 1)
            rows = layer(name, f"{first}-{last}", size, "--rows", "#FRAME_START#-#FRAME_END#")
            job.add_layer(rows)
            total.depend_all(rows)
    job.add_layer(total)
    return job


def layer(name, frames, chunk, *words):
    """A layer whose frames run the command with `words` appended."""
    # Cuebot replaces its tokens in the whole text. The host then passes the text to a shell, so
    # everything but the tokens is quoted.
    text = [word if word[0] == "#" else shlex.quote(word) for word in (*COMMAND, *words)]
    shell = Shell(
        name,
        command=text,
        range=frames,
        chunk=chunk,
        cores={{cores}},
        memory="{{memory_mb}}m",
        threadable={{cores}} > 1,
    )
    shell.set_env("RAYON_NUM_THREADS", "{{cores}}")
    return shell


if __name__ == "__main__":
    launcher = outline.cuerun.OutlineLauncher(build())
    if sys.argv[1:] == ["--print"]:
        print(launcher.serialize(use_pycuerun=False))
    else:
        launcher.launch(use_pycuerun=False)
