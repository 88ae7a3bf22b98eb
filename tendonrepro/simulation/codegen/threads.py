"""The time loop of one experiment as C, for a thread of a GPU; as C++ the same text runs on a processor.

Its functions are those of the lanes, on rows of one number. What depends on parameters alone is worked out
before the first sample.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from tendonrepro.arrays import Numeric
from tendonrepro.simulation.codegen.lanes import LaneRows, LaneTape, prepared_rows
from tendonrepro.simulation.codegen.printed import C_BEGINNING, C, function_source
from tendonrepro.simulation.codegen.symbols import Line

ENTRY = "experiments"
"""Name of the function that a device starts."""

THREAD = replace(
    C,
    head="DEVICE void {name}({arrays},double sample,double time){{",
    names={**C.names, "exp2": "two_to"},
)

_BEGINNING = (
    C_BEGINNING
    + """#ifdef __CUDACC__
#ifndef INFINITY
#define INFINITY __longlong_as_double(0x7ff0000000000000LL)
#endif
DEVICE long long bits_of(double x){return __double_as_longlong(x);}
DEVICE double of_bits(long long x){return __longlong_as_double(x);}
#else
#include <cstring>
DEVICE long long bits_of(double x){long long y;std::memcpy(&y,&x,sizeof y);return y;}
DEVICE double of_bits(long long x){double y;std::memcpy(&y,&x,sizeof y);return y;}
#endif
// As frexp gives them, of a positive normal number; and powers of two and of minus one with whole exponents.
DEVICE double mantissa(double x){return of_bits((bits_of(x)&0xfffffffffffffLL)|(1022LL<<52));}
DEVICE double exponent(double x){return (double)((bits_of(x)>>52)-1022LL);}
DEVICE double two_to(double x){return of_bits(((long long)x+1023LL)<<52);}
DEVICE double alternating(double x){return 1.0-2.0*(double)((long long)x&1LL);}
"""
)

_LOOP = """
DEVICE void experiment(long long lane,long long first,long long last,double period,long long count,
  double *all,const double *motions,const long long *motion_of,const double *noises,
  const long long *noise_of,long long each,double *blocks){
double rows[@ROWS@];
if(!(all[@LIVE@*count+lane]>0.0))return;
for(int i=0;i<@ROWS@;++i)rows[i]=all[i*count+lane];
if(first==0){@PREPARE@}
const double *desired=motions+motion_of[lane]*(last-first)*@SIGNALS@;
const double *noise=noises+noise_of[lane]*(last-first)*@SIGNALS@;
for(long long k=first;k<last;++k){
double sample_number=(double)k,now=sample_number*period;
for(int j=0;j<@SIGNALS@;++j){
rows[@DESIRED@+j]=desired[(k-first)*@SIGNALS@+j];
rows[@NOISE@+j]=noise[(k-first)*@SIGNALS@+j];
}
sample(rows,sample_number,now);
for(int j=0;j<@JOINTS@;++j)blocks[((k-first)/each*@JOINTS@+j)*count+lane]=rows[@BLOCK@+j];
if(!(rows[@LIVE@]>0.0))break;
begin(rows,sample_number,now);
while(rows[@LEFT@]>0.0)step(rows,sample_number,now);
}
for(int i=0;i<@ROWS@;++i)all[i*count+lane]=rows[i];
}
#define PARAMETERS long long first,long long last,double period,long long count,double *all,\\
const double *motions,const long long *motion_of,const double *noises,const long long *noise_of,\\
long long each,double *blocks
#define ARGUMENTS first,last,period,count,all,motions,motion_of,noises,noise_of,each,blocks
#ifdef __CUDACC__
extern "C" __global__ void @ENTRY@(PARAMETERS){
long long lane=blockIdx.x*(long long)blockDim.x+threadIdx.x;
if(lane<count)experiment(lane,ARGUMENTS);
}
#else
extern "C" void @ENTRY@(PARAMETERS){for(long long lane=0;lane<count;++lane)experiment(lane,ARGUMENTS);}
#endif
"""
"""Experiments from a sample to another.

``all`` (rows, count) are the rows of every experiment, before and after. ``motions`` and ``noises`` (number,
samples, signals) begin at the first sample. ``blocks`` (entries, joints, count) receives the block row, with
``each`` samples to an entry.
"""


def function(name: str, tape: LaneTape, results: Mapping[int, Numeric], rows: LaneRows) -> str:
    """Source of ``<name>(rows, sample, time)`` and of ``prepare_<name>``; results are by row."""
    read, prepared = prepared_rows(name, tape, results, rows)
    body = {("rows", row): value for row, value in results.items()}
    first = {("rows", row): value for row, value in prepared.items()}
    return "\n".join(
        (
            function_source(f"prepare_{name}", _in_rows(tape.lines), first, ("rows",), THREAD),
            function_source(name, _in_rows(read), body, ("rows",), THREAD),
        )
    )


def _in_rows(lines: Mapping[str, Line]) -> dict[str, Line]:
    """Rows as places of one array."""
    return {
        name: ("input", ("rows", operands[0])) if operation == "row" else (operation, operands)
        for name, (operation, operands) in lines.items()
    }


def source(functions: Sequence[str], names: Sequence[str], rows: LaneRows, sizes: Mapping[str, int]) -> str:
    """Source of `ENTRY`, with functions ``sample``, ``begin`` and ``step`` of some rows.

    ``sizes`` are the numbers of rows named ``desired`` and ``block``.
    """
    prepare = "".join(f"prepare_{name}(rows,0.0,0.0);" for name in names)
    places: dict[str, int | str] = {
        "ROWS": rows.count,
        "LIVE": rows.named["live"],
        "LEFT": rows.named["left"],
        "DESIRED": rows.named["desired"],
        "NOISE": rows.named["noise"],
        "BLOCK": rows.named["block"],
        "SIGNALS": sizes["desired"],
        "JOINTS": sizes["block"],
        "PREPARE": prepare,
        "ENTRY": ENTRY,
    }
    loop = _LOOP
    for word, text in places.items():
        loop = loop.replace(f"@{word}@", str(text))
    return "\n".join((_BEGINNING, *functions, loop))
