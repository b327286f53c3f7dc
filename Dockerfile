# The two commands of the README in a container without root:
#   docker build -t highd-lc .
#   docker run --rm -v "$PWD/reports:/home/analyst/reports" highd-lc validate
#   docker run --rm highd-lc test
# The folder for the reports has to be writable for user id 1000, which is analyst's.
# Data: -v /path/to/highd:/home/analyst/highd_lc/data/highd:ro
FROM python:3.12-slim

RUN apt-get update \
 && apt-get install --yes --no-install-recommends make \
 && rm -rf /var/lib/apt/lists/* \
 && useradd --create-home --uid 1000 analyst

USER analyst
# Made here, since not every builder gives a WORKDIR to the user.
RUN mkdir /home/analyst/highd_lc
WORKDIR /home/analyst/highd_lc
COPY --chown=analyst . .
RUN make setup-dev && mkdir -p /home/analyst/reports
ENV REPORTS=/home/analyst/reports WORK=/home/analyst/work

ENTRYPOINT ["make"]
CMD ["validate"]
