"""The broadcast messages bit by bit, as receivers hand them on, collected into the tables of ``insgnss.tables``."""
