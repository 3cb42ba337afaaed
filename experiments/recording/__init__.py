"""One recording on disk: how ticks are written, checked and read."""

STREAM_SUFFIX, PARQUET_SUFFIX = ".arrows", ".parquet"  # of a recording while its trial runs, and of a finished one
