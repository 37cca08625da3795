# The commands of surf.md; run it in the folder of a checkout.
set -eu
fitmodels datasets/surf_table1/data.csv --law "Ra ~ F" --form Ra=exponential --law "F ~ f" --out surf-fit
fitmodels roughness surf-fit/unnamed-tool_Ck-45/params.json Ra=1.6um n=610rpm f=0.2mm/rev r=0.8mm --step docs/examples/servo-steps.csv
fitmodels replay surf-fit/unnamed-tool_Ck-45/params.json --system roughness
fitmodels check surf-fit/unnamed-tool_Ck-45/params.json
fitmodels export surf-fit/unnamed-tool_Ck-45/params.json --system roughness --to c --out surf.c
